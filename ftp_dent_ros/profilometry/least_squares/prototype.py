"""Pipeline, being developed."""
from __future__ import annotations
import math
import cv2
import numpy as np
from ftp_dent_ros.profilometry.carrier import Carrier, ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.least_squares.first_fit import ReferenceTable, fit
from ftp_dent_ros.profilometry.least_squares.grid import Grid, Spreader
from ftp_dent_ros.profilometry.least_squares.sight import Sight, rays_at
from ftp_dent_ros.profilometry.least_squares.surface import evaluate, robust_quadric
from ftp_dent_ros.profilometry.least_squares.windows import WIDTH, Windows
from ftp_dent_ros.profilometry.least_squares.shrinkage import shrink
from ftp_dent_ros.profilometry.unwrapping import unwrap, wrap
from ftp_dent_ros.profilometry import stripe as stripes
from ftp_dent_ros.cloud import Cloud

def smoothed_const(v,w,k):
    return cv2.GaussianBlur(v,(0,0),sigmaX=k*w.sigma_u,sigmaY=k*w.sigma_v,borderType=cv2.BORDER_CONSTANT)

class LS:
    def __init__(self, rig, pattern, stride=1, **opt):
        self.rig, self.pattern, self.stride = rig, pattern, stride
        self.o = dict(thr=.25, pub_erode=0, twice=0,lk=(4,),dm=1,floor=.5,harm=1,me=3,se=3,rounds=2,s0=.5,ek=1.5,clip=248,thrk=4,tight=.05,tightk=4,rimu=1,rimv=1,er=1, shrink=2,power=2,lam=2,rho=.03,ew=1.5); self.o.update(opt)
        far = ReferencePlane(4 * float(np.linalg.norm(rig.translation)))
        self.carrier = carrier_on(rig, pattern, far)
        g = self.grid = Grid.for_fringes(rig.camera.width, rig.camera.height, self.carrier.period)
        self.windows = Windows.for_fringes(self.carrier.period, g)
        self.bins = Sight.of(rig, pattern, *g.bin_positions())
        self.nodes = Sight.of(rig, pattern, *g.node_positions())
        self.table = ReferenceTable.of(g, self.windows, self.bins, self.nodes, far.depth, 0.)
        self.spreader = Spreader.of(g, stride)
        self.rays = rays_at(rig.camera, np.arange(0, rig.camera.width, stride), np.arange(0, rig.camera.height, stride))

    def find_order(self, phase_nodes, part_nodes, red, gb):
        g=self.grid
        rows=np.arange(g.shape[0]) if g.shape[0]<80 else np.linspace(0,g.shape[0]-1,64).astype(int)
        # phase at bins for chosen rows
        d=cv2.resize(phase_nodes[rows]-self.table.node_phase[rows],(g.bin_shape[1],len(rows)),interpolation=cv2.INTER_LINEAR)
        ph=self.table.phase[rows]+d
        part=np.repeat(part_nodes[rows],2,axis=1)
        fr=stripes._fringes(ph,part,red[rows],gb[rows])
        loss,weight=stripes._losses(fr)
        chosen=stripes._elect(fr,loss,weight)&(loss>.5)
        orders={}
        for p in np.unique(fr.part[chosen]):
            o=fr.order[chosen&(fr.part==p)]
            orders[int(p)]=int(np.bincount(o-o.min()).argmax()+o.min())
        return orders

    def measure(self, image):
        g,w=self.grid,self.windows
        red=g.binned(image[...,0]); grey=g.binned(cv2.cvtColor(image,cv2.COLOR_RGB2GRAY))
        gb=(grey-.299*red)/.701
        f=fit(g,w,self.table,red)
        nu,nv=(math.ceil(self.carrier.period/p) for p in g.pitch)
        shoulder=cv2.dilate(f.modulation,np.ones((2*nv+1,2*nu+1),np.uint8))
        lit=f.modulation>2.5
        ru,rv=math.ceil(2*w.sigma_u)+nu,math.ceil(2*w.sigma_v)+nv
        far=cv2.erode(lit.astype(np.uint8),np.ones((2*rv+1,2*ru+1),np.uint8),borderValue=1)>0
        wide=np.ones((2*nv+1,4*nu+1),np.uint8)
        valley=cv2.morphologyEx(f.modulation,cv2.MORPH_CLOSE,wide)
        region=lit&(far|(f.modulation>.5*shoulder))&(f.modulation>.6*valley)
        un=unwrap(f.shift,region,jump=np.pi/2)
        phase=self.table.node_phase+un.phase
        orders=self.find_order(phase,un.part,red,gb)
        self.dbg=dict(f=f,region=region,un=un,phase=phase,orders=orders,red=red,grey=grey,gb=gb)
        out=None
        for p,n in orders.items():
            reg=un.part==p
            r=self.refine(red,grey,gb,reg,phase-2*np.pi*n)
            out=r
        return out

    def refine(self, red, grey, gb, region, phase):
        g,w=self.grid,self.windows
        inv,_=self.nodes.meet(phase)
        inner=cv2.erode(region.astype(np.uint8),np.ones((2*math.ceil(3*w.sigma_v)+1,2*math.ceil(3*w.sigma_u)+1)),borderValue=0)>0
        use=inner if inner.sum()>.2*region.sum() else region
        q=robust_quadric(self.nodes.rays[use],inv[use])
        node_q=self.nodes.phase(evaluate(q,self.nodes.rays))
        # start of the shift about the quadric, carried on beyond the interior
        seed=cv2.erode(region.astype(np.uint8),np.ones((2*self.o['se']+1,)*2),borderValue=0)>0
        u=np.where(seed,phase-node_q,0).astype(np.float32)
        U=self.linear(u,seed)
        base=self.bins.phase(evaluate(q,self.bins.rays))
        model=base+g.at_bins(U)
        reg=np.repeat(region,2,axis=1)
        instripe=np.abs(model)<np.pi+.9
        m0=reg.astype(np.float32)
        light,clip=self.light(red,grey,instripe,m0)
        m0=cv2.erode(m0,np.ones((3,2*self.o['me']+1)),borderValue=0)*~clip
        for turn in range(self.o['rounds']):
            a,b,dd=self.amplitude(light,np.cos(model),np.sin(model),m0)
            U=U+dd*(1 if turn==0 else 0)
            model=base+g.at_bins(U)
            c,s=np.cos(model),np.sin(model)
            bb=g.at_bins(b)
            pred=g.at_bins(a)+bb*c
            if self.o['harm']:
                sub=(slice(None,None,3),)
                mm=m0[sub]*bb[sub]; cc=c[sub]; rr=((light-pred)*m0)[sub]
                C2=2*cc*cc-1; C3=cc*(4*cc*cc-3)
                A=np.stack([(mm*C2).ravel(),(mm*C3).ravel()])
                h2,h3=np.linalg.solve(A@A.T,A@rr.ravel()).astype(np.float32)
                pred=pred+bb*(h2*(2*c*c-1)+h3*c*(4*c*c-3))
                self.dbg.update(h=(h2,h3))
            rho=(light-pred)/np.maximum(bb,1)
            cand=cv2.dilate(reg.astype(np.uint8),np.ones((3,5)))>0
            spread=1.4826*np.median(np.abs(rho[m0>0]))
            thr=max(self.o['thr'],self.o['thrk']*spread)
            good=(np.abs(rho)<thr)&cand&~clip
            k=2*math.ceil(.6*self.carrier.period/g.step)+1
            body=cv2.morphologyEx((good|clip&cand).astype(np.uint8),cv2.MORPH_CLOSE,np.ones((5,k)))
            core=cv2.erode(body,np.ones((2*self.o['rimv']+1,int(2*self.o['rimu']*self.carrier.period/g.step)+1)),borderValue=0)>0
            tight=max(self.o['tight'],self.o['tightk']*spread)
            good&=core|(np.abs(rho)<tight)
            m1=good.astype(np.float32)
            hole=(core&~good).astype(np.float32)
            r=(light-pred)*m1
            zc=w.flat_top(g.at_nodes(r*c)); zs=w.flat_top(g.at_nodes(r*s))
            if self.o['dm']: D=w.flat_top(g.at_nodes(2*m1*s*s))
            else: D=1-w.flat_top(g.at_nodes(2*hole*s*s)) if hole.any() else np.float32(1)
            D=np.maximum(D,np.float32(self.o['floor']))
            d=np.arctan2(-2*zs/D,b+2*zc)
            sup=w.gaussian(g.at_nodes(m1))
            sig=w.gaussian(g.at_nodes(r*r),2)/np.maximum(w.gaussian(g.at_nodes(m1),2),.05)
            var=2*sig/np.maximum(b,1)**2/(6.85*(WIDTH*self.carrier.period)**2/(4*g.step))
            var=np.maximum(var,1e-8)
            ins=sup>.5
            if turn+1<self.o['rounds']:
                m0=good.astype(np.float32)
                U=U+d
                if self.o['shrink']>1:
                    U=shrink(self.linear(U,ins),self.extended(var,ins),ins,w,4,self.o).values
                model=base+g.at_bins(U)
        if self.o['twice']: d2=2*d-w.flat_top(d)
        else: d2=d
        total=U+d2
        if self.o['shrink']:
            sh=shrink(self.linear(total,ins),self.extended(var,ins),ins,w,self.o['power'],self.o)
            total=sh.values
            self.dbg.update(sh=sh,var=var,ins=ins)
        self.dbg.update(q=q,node_q=node_q,U=U,model=model,m0=m0,light=light,a=a,b=b,rho=rho,good=good,D=D,d=d,d2=d2,clip=clip,total=total,thr=thr,spread=spread,use=use)
        inv,v_p=self.nodes.meet(node_q+total)
        pub=cv2.morphologyEx((good|clip&core).astype(np.uint8),cv2.MORPH_OPEN,np.ones((2,3)))
        pub=cv2.morphologyEx(pub,cv2.MORPH_CLOSE,np.ones((5,k)))
        u_p=self.pattern.column(g.at_bins(node_q+total)); vb=g.at_bins(v_p)
        inset=1.0
        P=self.rig.projector
        pub=(pub>0)&(u_p>inset)&(u_p<P.width-1-inset)&(vb>inset)&(vb<P.height-1-inset)
        self.dbg.update(pub=pub)
        return self.cloud(inv,pub,b)

    def extended(self,u,ok):
        w=self.windows
        m=ok.astype(np.float32)
        u=np.where(ok,u,0).astype(np.float32)
        out=u
        for k in (1.5,4):
            den=w.gaussian(m,k)
            out=np.where(m>0,out,np.where(den>.01,w.gaussian(out*m,k)/np.maximum(den,.01),0)).astype(np.float32)
            m=np.maximum(m,(den>.01)).astype(np.float32)
        return out

    def linear(self,u,ok):
        if ok.all(): return u
        w=self.windows
        m=ok.astype(np.float32)
        u=np.where(ok,u,0).astype(np.float32)
        gx=np.zeros_like(u); gy=np.zeros_like(u)
        px=np.zeros_like(u); py=np.zeros_like(u)
        px[:,1:-1]=m[:,2:]*m[:,:-2]; gx[:,1:-1]=(u[:,2:]-u[:,:-2])/2*px[:,1:-1]
        py[1:-1]=m[2:]*m[:-2]; gy[1:-1]=(u[2:]-u[:-2])/2*py[1:-1]
        y,x=np.mgrid[:u.shape[0],:u.shape[1]].astype(np.float32)
        out=u; known=ok
        for k in self.o['lk']:
            G=lambda v: smoothed_const(v,w,k)
            den=G(m); den_=np.maximum(den,1e-3)
            g=lambda v,n: G(v)/np.maximum(G(n),1e-3)
            ext=G(m*u)/den_-(G(m*x)/den_-x)*g(gx,px)-(G(m*y)/den_-y)*g(gy,py)
            out=np.where(known,out,np.where(den>.01,ext,0)).astype(np.float32)
            known=known|(den>.01)
        return out

    def light(self, red, grey, instripe, m0):
        cols=np.flatnonzero((instripe&(m0>0)).any(0))
        clip=np.maximum(red,grey)>self.o['clip']
        if len(cols)==0: return grey,clip
        k=3*math.ceil(self.carrier.period/self.grid.step)
        sl=slice(max(cols[0]-k,0),cols[-1]+k+1)
        R,L,I=red[:,sl],grey[:,sl],instripe[:,sl]
        m=m0[:,sl]*~I
        def G(x): return cv2.GaussianBlur(x,(0,0),sigmaX=k/3,sigmaY=2.5,borderType=cv2.BORDER_CONSTANT)
        S,SR,SL,RR,RL=(G(x.astype(np.float32)) for x in (m,m*R,m*L,m*R*R,m*R*L))
        S=np.maximum(S,1e-3)
        slope=(RL-SR*SL/S)/np.maximum(RR-SR*SR/S,1e-3)
        off=(SL-slope*SR)/S
        out=grey.copy()
        out[:,sl]=np.where(I,off+slope*R,L)
        return out,clip

    def amplitude(self, light, c, s, m):
        g,w=self.grid,self.windows
        G=lambda x: w.gaussian(g.at_nodes(x))
        mc,ms=m*c,m*s
        S0,S1,S2,S11,S12=G(m),G(mc),G(ms),G(mc*c),G(mc*s)
        S22=S0-S11
        ml=m*light
        T0,T1,T2=G(ml),G(ml*c),G(ml*s)
        ok=S0>self.o['s0']
        i0=1/np.where(ok,S0,1)
        S1,S2,T0m=S1*i0,S2*i0,T0*i0
        A=S11*i0-S1*S1; B=S12*i0-S1*S2; C=S22*i0-S2*S2
        p=T1*i0-T0m*S1; q=T2*i0-T0m*S2
        det=A*C-B*B
        ok&=det>.05
        det=np.where(ok,det,1)
        x=(C*p-B*q)/det; y=(A*q-B*p)/det
        a=T0m-x*S1-y*S2
        d=np.arctan2(-y,x); b=np.hypot(x,y)
        ext=lambda v: self.extended(v,ok)
        return ext(a),ext(b),self.linear(d,ok)

    def cloud(self, inv, pub, b):
        g=self.grid
        z=1/self.spreader.spread(np.nan_to_num(inv,nan=1.,posinf=1.).astype(np.float32))
        mask=np.repeat(np.repeat(pub,4,axis=0),g.step,axis=1)[:g.height:self.stride,:g.width:self.stride][:g.height]
        mask=np.repeat(np.repeat(pub,4,axis=0),g.step,axis=1)[:g.height,:g.width][::self.stride,::self.stride]
        z=np.where(mask,z,np.nan).astype(np.float32)
        pts=np.concatenate([self.rays*z[...,None],z[...,None]],axis=-1)
        return Cloud(pts,np.where(mask,z*0+1,0))
